"""The laboratory: campaign, judge, benchmarks and equipment of the pages. No wheel holds it."""
