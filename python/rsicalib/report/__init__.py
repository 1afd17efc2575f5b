"""The report of a result: one HTML file and its figures (`page`), and the terminal's summary."""
