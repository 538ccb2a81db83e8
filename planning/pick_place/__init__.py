"""The search for a pick and a place that go together."""
