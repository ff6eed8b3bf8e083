"""The command `simyard`, here so that it says what hides Simyard's packages, if anything does."""

from flows.cli.shell import main

if __name__ == "__main__":
    main()
