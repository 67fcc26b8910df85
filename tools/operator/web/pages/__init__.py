"""Pages as the console's process holds them: each an operator, one session behind them all."""
