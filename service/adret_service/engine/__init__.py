"""The queue of jobs behind one port: a durable engine and its in-memory twin."""
