"""Raw loops over arrays: no validation, no options, no imports from the modules above."""
