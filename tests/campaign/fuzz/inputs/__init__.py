"""Inputs of the fuzzer: values, messages, news, and a stranger on the network."""
