"""One call of a verb: from its arguments to a session of the core, and back to a result."""
