"""The report of a result: one HTML file (`page`), and the summary for a terminal (`terminal`)."""
