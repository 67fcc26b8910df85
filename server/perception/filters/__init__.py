"""What is believed of news: pure functions of what was known and what was told."""
