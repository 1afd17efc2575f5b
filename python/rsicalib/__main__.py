"""`python -m rsicalib` is the command `rsicalib`."""

from rsicalib.cli.verbs import main

main()
