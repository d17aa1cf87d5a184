"""The simulator against solutions and measurements that it did not make."""
