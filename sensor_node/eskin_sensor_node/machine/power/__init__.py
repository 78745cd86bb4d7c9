"""The node's supply: supercapacitor, harvesters, and the loads of the machine's work."""
