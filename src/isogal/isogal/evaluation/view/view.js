"use strict";
// The page of `isogal view`: fills Bokeh's data sources from the numbers in the page, moves
// everything to the time of the slider, and asks the server for more while a run is watched.
(function () {
  const POINTS = 48, CHI95 = Math.sqrt(5.991); // 95 % of a Gaussian in the plane
  const LOOK = { WARN: ["#E69F00", "triangle"], ERROR: ["#D55E00", "square"],
                 STALE: ["#888888", "diamond"] };
  const byId = (id) => document.getElementById(id);
  const slider = byId("time"), view = { ready: false, index: 0, batch: -1, data: null };
  let model, timer = null, last = 0, simulated = 0;

  const column = (values) => Float64Array.from(values, (v) => (v === null ? NaN : v));
  const source = (name) => model(name);
  const set = (name, data) => { source(name).data = data; };

  function ellipse(x, y, nn, ne, ee, kx, ky, size) {
    // Points of the ellipse of a covariance (north, east; m²) about a place on the map (km).
    const trace = nn + ee, root = Math.sqrt(Math.max((nn - ee) ** 2 + 4 * ne * ne, 0));
    const major = size * Math.sqrt(Math.max((trace + root) / 2, 0));
    const minor = size * Math.sqrt(Math.max((trace - root) / 2, 0));
    const turn = 0.5 * Math.atan2(2 * ne, nn - ee); // of the major axis from north to east
    const xs = [], ys = [];
    for (let i = 0; i <= POINTS; i++) {
      const a = (2 * Math.PI * i) / POINTS, u = major * Math.cos(a), v = minor * Math.sin(a);
      ys.push(y + ky * (u * Math.cos(turn) - v * Math.sin(turn)));
      xs.push(x + kx * (u * Math.sin(turn) + v * Math.cos(turn)));
    }
    return [xs, ys];
  }

  function batchText(b, i) {
    const when = clock(b.t[i]);
    if (b.reason[i] !== null) return `${when}: no fix: ${b.reason[i]}`;
    const apart = metres(Math.hypot(b.north[i], b.east[i]));
    return `${when}: fix, ${apart} from the ${view.data.is_true ? "truth" : "navigator"}, sigma north `
      + `${metres(Math.sqrt(b.nn[i]))}, east ${metres(Math.sqrt(b.ee[i]))}`;
  }

  function load(data) {
    view.data = data;
    const s = data.states, b = data.batches, band = (name, variance, sign) =>
      Float64Array.from(s[variance], (v) => sign * 3 * Math.sqrt(v === null ? NaN : v));
    const all = {};
    for (const name of Object.keys(s)) all[name] = column(s[name]);
    const known = data.is_true ? all : { x: all.x.map(() => NaN), y: all.y.map(() => NaN) };
    set("tracks", { x: known.x, y: known.y, aided_x: all.aided_x, aided_y: all.aided_y,
                    unaided_x: all.unaided_x, unaided_y: all.unaided_y });
    set("states", { t: all.t, error: all.error, unaided: all.unaided, level: all.level,
      sigma: all.nn.map((v, i) => Math.sqrt(v + all.ee[i])), north: all.north, east: all.east,
      north_low: band("north", "nn", -1), north_high: band("north", "nn", 1),
      east_low: band("east", "ee", -1), east_high: band("east", "ee", 1), nees: all.nees });
    const fixed = b.reason.map((r) => r === null);
    set("after_fixes", { t: column(b.t.filter((_, i) => fixed[i])),
                         nees: column(b.nees.filter((_, i) => fixed[i])) });
    logarithmic("errors", [all.error, all.unaided, all.level, source("states").data.sigma]);
    logarithmic("nees", [all.nees], 1e-3);
    for (const name of ["north", "east"])
      linear(name, [all[name], source("states").data[`${name}_low`],
                    source("states").data[`${name}_high`]]);
    const r = data.readings;
    linear("signal", [r.reading, r.truth, r.navigator]);
    linear("difference", [r.difference]);
    set("readings", { t: column(r.t), reading: column(r.reading), truth: column(r.truth),
                      navigator: column(r.navigator), difference: column(r.difference) });
    const e = data.events, texts = b.t.map((_, i) => batchText(b, i));
    set("events", {
      t: column(b.t.concat(e.t)),
      row: b.t.map(() => "fixes").concat(e.t.map(() => "messages")),
      colour: fixed.map((f) => (f ? "#009E73" : "#D55E00"))
        .concat(e.level.map((l) => (LOOK[l] || LOOK.WARN)[0])),
      marker: fixed.map((f) => (f ? "circle" : "x"))
        .concat(e.level.map((l) => (LOOK[l] || LOOK.WARN)[1])),
      text: texts.concat(e.text.map((t, i) => `${clock(e.t[i])}: ${e.level[i]}: ${e.source[i]}: `
        + t + (e.times[i] > 1 ? ` (${e.times[i]} times)` : ""))),
    });
    view.texts = texts;
    aids(data.aids, s.t[s.t.length - 1] || 1);
    view.half = fitted(s);
    hide(data.is_true, values([all.unaided_x]).length > 0);
    byId("missing").replaceChildren(...data.missing.map((text) => {
      const item = document.createElement("li");
      item.textContent = text;
      return item;
    }));
    const atEnd = view.index >= Number(slider.max);
    slider.max = String(s.t.length - 1);
    view.batch = -1;
    show(document.body.dataset.live && atEnd ? s.t.length - 1 : view.index);
  }

  function aids(uses, end) {
    // A band for each aid under the slider: green while it is used, grey while it is not.
    const bands = new Map();
    uses.aid.forEach((name, i) => {
      if (!bands.has(name)) {
        const band = document.createElement("div"), label = document.createElement("b");
        band.className = "aid";
        band.setAttribute("role", "listitem");
        label.textContent = name;
        band.append(label);
        bands.set(name, band);
      }
      const part = document.createElement("span"), from = Math.max(0, uses.begin[i]);
      part.className = uses.used[i] ? "used" : "";
      part.style.left = `${(100 * from) / end}%`;
      part.style.width = `${(100 * Math.max(0, Math.min(end, uses.end[i]) - from)) / end}%`;
      part.title = `${name}, ${clock(uses.begin[i])} to ${clock(uses.end[i])}: ${uses.text[i]}`;
      bands.get(name).prepend(part);
    });
    byId("aids").replaceChildren(...bands.values());
  }

  function hide(isTrue, hasUnaided) {
    // What is not known without the truth, or without an unaided INS.
    byId("figure_nees").hidden = !isTrue;
    for (const axis of ["North", "East"])
      byId(`figure_${axis.toLowerCase()}`).querySelector("h2").textContent =
        isTrue ? `${axis} error, and 3 sigma as claimed` : `${axis}: 3 sigma as claimed`;
    const absent = (isTrue ? [] : ["overview.y", "close_up.y", "errors.error", "errors.unaided", "signal.truth"])
      .concat(hasUnaided ? [] : ["overview.unaided_y", "close_up.unaided_y", "errors.unaided"]);
    for (const entry of document.querySelectorAll(".key"))
      entry.hidden = absent.includes(entry.dataset.name);
  }

  // Ranges are set here: Bokeh finds none for data that come late.
  function values(columns) {
    return columns.flatMap((c) => Array.from(c)).filter(Number.isFinite);
  }

  function limits(name, start, end) {
    model(name).y_range.setv({ start, end, reset_start: start, reset_end: end });
  }

  function logarithmic(name, columns, least = 1) {
    const known = values(columns).filter((v) => v > 0);
    const high = known.reduce((a, v) => Math.max(a, v), 10 * least);
    const low = known.reduce((a, v) => Math.min(a, v), high);
    limits(name, Math.max(0.7 * low, least), 1.4 * high);
  }

  function linear(name, columns) {
    const known = values(columns);
    const high = known.reduce((a, v) => Math.max(a, v), -Infinity);
    const low = known.reduce((a, v) => Math.min(a, v), Infinity);
    const margin = 0.05 * (high - low) || 1;
    if (known.length) limits(name, low - margin, high + margin);
  }

  function fitted(s) {
    // Half the width, km, that usually holds the protection level.
    const levels = values([s.level]).sort((p, q) => p - q);
    const usual = levels.length ? levels[Math.floor(0.8 * (levels.length - 1))] : 1000;
    return Math.min(30, Math.max(0.2, (1.6 * usual) / 1000));
  }

  function show(index) {
    if (!view.data) return; // of a run that is watched, before its first reading
    const s = view.data.states;
    index = Math.max(0, Math.min(s.t.length - 1, Math.round(index)));
    view.index = index;
    slider.value = String(index);
    slider.setAttribute("aria-valuetext", clock(s.t[index]));
    byId("clock").textContent = clock(s.t[index]);
    model("cursor").location = s.t[index];
    places(s, index);
    batches(s.t[index]);
    frame(s, index);
    readout(s, index);
  }

  function places(s, k) {
    const place = (x) => (view.data.is_true ? x : null);
    set("now", { x: column([s.unaided_x[k], place(s.x[k]), s.aided_x[k]]),
      y: column([s.unaided_y[k], place(s.y[k]), s.aided_y[k]]),
      colour: ["#D55E00", "#000000", "#0072B2"], marker: ["triangle", "square", "circle"] });
    const kx = s.east_scale[k], ky = s.north_scale[k];
    const [xs, ys] = ellipse(s.aided_x[k], s.aided_y[k], s.nn[k], s.ne[k], s.ee[k], kx, ky, CHI95);
    set("claimed", { xs: [xs], ys: [ys] });
    const [px, py] = s.level[k] === null ? [[], []]
      : ellipse(s.aided_x[k], s.aided_y[k], 1, 0, 1, kx, ky, s.level[k]);
    set("protection", { xs: [px], ys: [py] });
  }

  function batches(hours) {
    const b = view.data.batches;
    let batch = -1;
    while (batch + 1 < b.t.length && b.t[batch + 1] <= hours + 1e-6) batch++;
    if (batch === view.batch) return;
    view.batch = batch;
    const which = [...b.t.keys()].filter((i) => b.reason[i] === null);
    const alpha = which.map((i) => (i > batch ? 0.15 : i === batch ? 1 : 0.6));
    set("fixes", { x: column(which.map((i) => b.x[i])), y: column(which.map((i) => b.y[i])),
                   alpha, text: which.map((i) => view.texts[i]) });
    const drawn = which.map((i) => ellipse(b.x[i], b.y[i], b.nn[i], b.ne[i], b.ee[i],
      b.east_scale[i], b.north_scale[i], CHI95));
    set("fix_ellipses", { xs: drawn.map((d) => d[0]), ys: drawn.map((d) => d[1]), alpha });
    const c = batch < 0 ? null : view.data.candidates[batch];
    const most = c && c.weight.length ? Math.max(...c.weight) : 1;
    set("candidates", c ? { x: column(c.x), y: column(c.y),
      size: c.weight.map((w) => 4 + 10 * Math.sqrt(w / most)) } : { x: [], y: [], size: [] });
    const [xs, ys] = batch < 0 ? [[], []] : ellipse(b.after_x[batch], b.after_y[batch],
      b.after_nn[batch], b.after_ne[batch], b.after_ee[batch], b.east_scale[batch],
      b.north_scale[batch], CHI95);
    set("posterior", { xs: [xs], ys: [ys] });
  }

  function frame(s, k) {
    const plot = model("close_up");
    if (byId("follow").checked) {
      const chosen = byId("width").value;
      const half = (chosen === "auto" ? view.half : Number(chosen)) * (view.zoom || 1);
      const shape = plot.inner_width > 0 ? plot.inner_height / plot.inner_width : 1;
      const [wide, high] = shape < 1 ? [half / shape, half] : [half, half * shape];
      plot.x_range.setv({ start: s.x[k] - wide, end: s.x[k] + wide });
      plot.y_range.setv({ start: s.y[k] - high, end: s.y[k] + high });
    }
    set("frame", { left: [plot.x_range.start], right: [plot.x_range.end],
                   bottom: [plot.y_range.start], top: [plot.y_range.end] });
  }

  function readout(s, k) {
    const isTrue = view.data.is_true, rows = [
      ["latitude", `${s.latitude[k].toFixed(4)}°`], ["longitude", `${s.longitude[k].toFixed(4)}°`],
      isTrue && ["error", metres(s.error[k])],
      isTrue && ["north, east", `${metres(s.north[k])}, ${metres(s.east[k])}`],
      ["claimed sigma", metres(Math.sqrt(s.nn[k] + s.ee[k]))],
      isTrue && ["unaided", metres(s.unaided[k])],
      ["protection level", metres(s.level[k])],
      isTrue && ["NEES per axis", s.nees[k] === null ? "–" : s.nees[k].toPrecision(2)],
      ["last batch", view.batch < 0 ? "none yet" : view.texts[view.batch], "wide"],
    ].filter(Boolean);
    byId("readout").replaceChildren(...rows.map(([name, value, kind]) => {
      const row = document.createElement("div"), term = document.createElement("dt"),
        text = document.createElement("dd");
      term.textContent = name;
      text.textContent = text.title = value;
      row.append(term, text);
      row.className = kind || "";
      return row;
    }));
  }

  function metres(value) {
    if (value === null || !Number.isFinite(value)) return "–";
    const size = Math.abs(value);
    return size >= 1e4 ? `${(value / 1e3).toFixed(1)} km` : `${value.toFixed(size < 10 ? 1 : 0)} m`;
  }

  function clock(hours) {
    const seconds = Math.round(hours * 3600), pad = (n) => String(n).padStart(2, "0");
    return `${Math.floor(seconds / 3600)}:${pad(Math.floor(seconds / 60) % 60)}:${pad(seconds % 60)}`;
  }

  function nearest(values, wanted) {
    let best = 0;
    values.forEach((v, i) => { if (Math.abs(v - wanted) < Math.abs(values[best] - wanted)) best = i; });
    return best;
  }

  function play(on) {
    const button = byId("play");
    button.textContent = on ? "Stop" : "Play";
    button.setAttribute("aria-pressed", String(on));
    cancelAnimationFrame(timer);
    timer = null;
    if (!on || !view.data) return;
    const t = view.data.states.t;
    if (view.index >= t.length - 1) show(0);
    simulated = t[view.index];
    last = performance.now();
    const step = (now) => {
      simulated += ((now - last) / 3.6e6) * Number(byId("speed").value);
      last = now;
      let k = view.index;
      while (k + 1 < t.length && t[k + 1] <= simulated) k++;
      if (k !== view.index) show(k);
      if (k >= t.length - 1) play(false);
      else timer = requestAnimationFrame(step);
    };
    timer = requestAnimationFrame(step);
  }

  function fix(direction) {
    if (!view.data) return;
    const b = view.data.batches, now = view.data.states.t[view.index];
    const which = b.t.filter((t, i) => b.reason[i] === null
      && (direction > 0 ? t > now + 1e-6 : t < now - 1e-6));
    if (which.length) view.seek(direction > 0 ? which[0] : which[which.length - 1]);
  }

  function zoom(factor) { view.zoom = (view.zoom || 1) * factor; show(view.index); }

  function key(event) {
    const tag = event.target.tagName;
    if (!view.data || event.ctrlKey || event.altKey || event.metaKey || tag === "SELECT") return;
    if (event.key === " " && tag === "BUTTON") return;
    const s = view.data.states, many = nearest(s.t, s.t[view.index] + 1 / 6) - view.index || 1;
    const step = event.shiftKey ? many : 1, done = {
      " ": () => play(timer === null), ArrowRight: () => show(view.index + step),
      ArrowLeft: () => show(view.index - step), Home: () => show(0),
      End: () => show(s.t.length - 1), n: () => fix(1), p: () => fix(-1),
      "+": () => zoom(0.7), "-": () => zoom(1 / 0.7),
      f: () => { byId("follow").click(); },
    }[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (done) { done(); event.preventDefault(); }
  }

  view.seek = (hours) => view.data && show(nearest(view.data.states.t, hours));
  view.seekPlace = (x, y) => {
    if (!view.data) return;
    const s = view.data.states;
    show(nearest(s.x.map((v, i) => Math.hypot(v - x, s.y[i] - y)), 0));
  };
  view.load = load;
  window.isogalView = view;

  function wire() {
    slider.addEventListener("input", () => show(Number(slider.value)));
    byId("play").addEventListener("click", () => play(timer === null));
    byId("previous").addEventListener("click", () => fix(-1));
    byId("next").addEventListener("click", () => fix(1));
    for (const id of ["width", "follow"])
      byId(id).addEventListener("change", () => { view.zoom = 1; show(view.index); });
    for (const entry of document.querySelectorAll(".key"))
      entry.addEventListener("click", () => {
        const drawn = model(entry.dataset.name);
        drawn.visible = !drawn.visible;
        entry.setAttribute("aria-pressed", String(drawn.visible));
      });
    document.addEventListener("keydown", key);
    window.addEventListener("resize", () => setTimeout(() => { fitOverview(); show(view.index); }, 300));
  }

  function fitOverview() {
    // The whole map, at one scale in both directions.
    const plot = model("overview"), home = view.home;
    if (!(plot.inner_width > 0)) return;
    const scale = Math.max(home[2] / plot.inner_width, home[3] / plot.inner_height);
    const x = home[0] + home[2] / 2, y = home[1] + home[3] / 2;
    plot.x_range.setv({ start: x - (scale * plot.inner_width) / 2, end: x + (scale * plot.inner_width) / 2 });
    plot.y_range.setv({ start: y - (scale * plot.inner_height) / 2, end: y + (scale * plot.inner_height) / 2 });
  }

  async function watch() {
    // While a run is watched: new numbers each second, until the server ends.
    let seen = "";
    for (;;) {
      try {
        const answer = await fetch("state?seen=" + encodeURIComponent(seen));
        if (answer.status === 200) {
          seen = answer.headers.get("ETag") || "";
          load(await answer.json());
          ready();
        }
        byId("status").textContent = answer.headers.get("X-Status") || "";
      } catch (error) {
        byId("status").textContent = "the run has ended, or the server is gone";
        return;
      }
      await new Promise((resolve) => setTimeout(resolve, 1000));
    }
  }

  function ready() {
    if (view.ready) return;
    fitOverview();
    show(view.index);
    view.ready = true;
    document.body.dataset.ready = "true";
  }

  function start() {
    const document_ = window.Bokeh && window.Bokeh.documents[0];
    if (!document_ || !document_.get_model_by_name("said")) return setTimeout(start, 20);
    const known = new Map();
    model = (name) => {
      if (!known.has(name)) known.set(name, document_.get_model_by_name(name));
      return known.get(name);
    };
    const o = model("overview");
    view.home = [o.x_range.start, o.y_range.start, o.x_range.end - o.x_range.start,
                 o.y_range.end - o.y_range.start];
    const data = JSON.parse(byId("data").textContent);
    if (data !== null) load(data);
    const settled = () => {
      if (!(model("overview").inner_width > 0)) return setTimeout(settled, 20);
      if (data !== null) { wire(); ready(); } else wire();
      if (document.body.dataset.live) watch();
    };
    settled();
  }
  start();
})();
