"""What the fuzzer sends: values, messages, news, and a stranger on the network."""
