"""Contact that stops an arm: felt by its joints or its tool, and given way to until it is over."""
