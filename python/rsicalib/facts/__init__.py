"""What a result states, typed: its parts as the core's files hold them, by generated shapes."""
