"""The report of a result: one HTML file, and the summary for a terminal."""

from rsicalib.report.page import html
from rsicalib.report.terminal import summary

__all__ = ["html", "summary"]
