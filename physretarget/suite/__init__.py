"""Nightly runs: a whole library judged, compared with what was accepted, told in the morning.

    suite file ─ plan ─▶ jobs ─ run | dask ─▶ results ─ store ─▶ compare ─ site ─▶ report

A result has the address of everything it depends on (clip, model, settings, code), so work
that is unchanged is never done again. Needs the extra ``suite`` (SQLAlchemy) from the store on;
reading and planning need nothing.
"""
