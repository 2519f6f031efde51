"""Renderers of reports; none of them computes."""
