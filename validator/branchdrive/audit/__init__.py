"""The validator: rules over columnar views, an engine, verdicts and reports."""
