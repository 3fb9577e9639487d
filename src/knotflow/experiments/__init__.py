"""The stages of every experiment, a module a section of the paper or of the report."""
