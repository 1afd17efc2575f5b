"""The report of a result: one HTML file, and the summary for a terminal."""
