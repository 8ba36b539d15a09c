"""How good a navigator was: errors, consistency, the bound, figures, reports.

records            what runs leave behind, as arrays; files of them
results            how results.json and summary.json are written and read
summary            figures of merit of a set of runs
judgement          is a run worse than without aiding, or not what it claims?
integrity          is the error within its protection level? exceedances, Poisson intervals
consistency        NEES, and the chi-square intervals that it must lie in
bound              posterior Cramér–Rao bound; covariance of the unaided navigator
reading_errors     what the bound takes of the errors of readings
navigability       how good can it be over an area, by heading?
planning           which route lets the navigator arrive with the least error?
ins_error_model    the navigator's linear error model along a trajectory
figures            figures of runs
run_report         the report of `isogal run` and of `isogal montecarlo`
calibration_report the report of `isogal mag calibrate`
view               the page of `isogal view`
comparison         runs or studies side by side: `isogal compare`
html_report        HTML reports in general: sections, tables, figures, numbers as text
                   (their page: report.html)
"""
