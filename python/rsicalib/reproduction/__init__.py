"""The paper's tables and misprints, computed again beside what is printed."""
