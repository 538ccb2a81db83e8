"""What a run of trials comes to: figures, summary.json, and the page of its trials."""
