"""A session with a person at the handle: which pose next, how good already, when done."""
