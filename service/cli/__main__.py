"""python -m service.cli is the command lightlayers."""

from service.cli import main

main()
