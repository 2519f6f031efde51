"""One rule per file; the table of them is :mod:`physretarget.validation.codes`."""
