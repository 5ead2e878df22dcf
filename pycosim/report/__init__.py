"""Data set and search in; one self-contained HTML page, figures for print, and their numbers, out."""
