"""Forms of the report beside text: for other programs, for reviews and for the pages of a CI service."""
