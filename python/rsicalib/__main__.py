"""`python -m rsicalib` is the command `rsicalib`."""

from rsicalib.cli import main

main()
