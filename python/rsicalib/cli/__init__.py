"""The command `rsicalib`."""
