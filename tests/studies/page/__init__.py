"""What the operator's page costs a run, and how quickly it stops one, on emulated devices."""
