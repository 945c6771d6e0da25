"""A client of the service: typed calls, and the commands of the `adret` program that use them.

Nothing is imported here, because the command line loads `commands` at every start.
"""
