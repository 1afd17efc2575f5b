"""Before a session: what poses can tell, which to take, and what an effect would do."""
