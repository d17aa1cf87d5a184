"""What devices of every kind share: who answered, how a stream fares, clocks, faults."""
