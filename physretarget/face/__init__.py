"""From dense facial capture to an animator's curves (Ruhland, Prasad, McDonnell 2017)."""
