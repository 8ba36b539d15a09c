"""The page of an HTML report (a Jinja2 template).

The page refers to nothing outside its file; the environment escapes all text."""

PAGE = """\
<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>{{ title }}</title>
<style>
:root {
  --text: #1b1f24; --soft: #5a6470; --ground: #ffffff; --panel: #f5f6f8; --rule: #d9dde2;
  --accent: #0072b2;
}
@media (prefers-color-scheme: dark) {
  :root {
    --text: #e4e7eb; --soft: #9aa5b1; --ground: #14171b; --panel: #1d2127; --rule: #363c45;
    --accent: #56b4e9;
  }
}
* { box-sizing: border-box; }
body {
  margin: 0; background: var(--ground); color: var(--text);
  font: 16px/1.55 system-ui, "Segoe UI", "DejaVu Sans", sans-serif;
}
main { max-width: 62rem; margin: 0 auto; padding: 2rem 1.25rem 4rem; }
h1 { font-size: 1.7rem; line-height: 1.25; margin: 0 0 .3rem; }
h2 {
  font-size: 1.25rem; margin: 2.6rem 0 .6rem; padding-top: .6rem;
  border-top: 1px solid var(--rule);
}
p { margin: .6rem 0; max-width: 46rem; }
p.subtitle { color: var(--soft); margin-top: 0; }
nav { margin: 1rem 0 0; font-size: .92rem; }
nav a { margin-right: 1.1rem; }
a { color: var(--accent); }
figure { margin: 1.4rem 0; }
figure img {
  display: block; width: 100%; max-width: 1065px; height: auto; background: #fff;
  border: 1px solid var(--rule); border-radius: 4px; padding: .5rem;
}
figcaption, caption { color: var(--soft); font-size: .9rem; text-align: left; }
figcaption { margin-top: .4rem; max-width: 54rem; }
figcaption b, caption b { color: var(--text); }
.scroll { overflow-x: auto; margin: 1.2rem 0; }
table { border-collapse: collapse; font-size: .92rem; font-variant-numeric: tabular-nums; }
caption { caption-side: top; padding-bottom: .4rem; }
th, td {
  padding: .3rem .8rem .3rem 0; text-align: left; vertical-align: top;
  border-bottom: 1px solid var(--rule);
}
thead th { border-bottom: 2px solid var(--soft); }
td.number, th.number { text-align: right; }
details { margin: 1rem 0; }
summary { cursor: pointer; color: var(--accent); }
pre {
  background: var(--panel); padding: .8rem 1rem; overflow-x: auto; font-size: .85rem;
  border-radius: 4px;
}
footer {
  margin-top: 3rem; color: var(--soft); font-size: .85rem; border-top: 1px solid var(--rule);
  padding-top: .6rem;
}
@media print { nav, summary { display: none; } figure, tr { break-inside: avoid; } }
</style>
</head>
<body>
<main>
<h1>{{ title }}</h1>
{% if subtitle %}<p class="subtitle">{{ subtitle }}</p>
{% endif %}
{%- if sections | length > 2 %}<nav>
{%- for section in sections %}<a href="#s{{ loop.index }}">{{ section.heading }}</a>{% endfor -%}
</nav>
{% endif %}
{%- macro kind(table, column) %}
{%- if column in table.numeric %} class="number"{% endif %}
{%- endmacro %}
{%- macro show(table) %}
<div class="scroll"><table>
<caption><b>Table {{ numbers[table] }}.</b> {{ table.caption }}</caption>
<thead><tr>
{%- for name in table.header %}<th scope="col"{{ kind(table, loop.index0) }}>{{ name }}</th>
{%- endfor %}</tr></thead>
<tbody>
{% for row in table.rows %}<tr>
{%- for cell in row %}<td{{ kind(table, loop.index0) }}>{{ cell }}</td>{% endfor %}</tr>
{% endfor %}</tbody>
</table></div>
{% endmacro %}
{%- for table in tables %}{{ show(table) }}{% endfor %}
{%- for section in sections %}
<h2 id="s{{ loop.index }}">{{ section.heading }}</h2>
{% for paragraph in section.paragraphs %}<p>{{ paragraph }}</p>
{% endfor %}
{%- for picture in section.illustrations %}
<figure>
<img src="data:image/png;base64,{{ data[picture.name] }}" alt="{{ picture.caption }}">
<figcaption><b>Figure {{ figure_numbers[picture.name] }}.</b> {{ picture.caption }}</figcaption>
</figure>
{% endfor %}
{%- for table in section.tables %}{% if table.folded %}
<details><summary>{{ table.caption }}</summary>{{ show(table) }}</details>
{% else %}{{ show(table) }}{% endif %}{% endfor %}
{%- if section.listing %}
<details><summary>{{ section.listing_title }}</summary><pre>{{ section.listing }}</pre></details>
{% endif %}
{%- endfor %}
<footer>{{ footer }}</footer>
</main>
</body>
</html>
"""
