"""The laboratory: campaign, judge, benchmarks, papers and equipment of the pages. No wheel holds it."""
