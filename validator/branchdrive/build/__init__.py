"""Building a release: what turns a raw layer into canonical, quality and model layers, with a card and a licence."""
