"""The model of delivery (`docs/model`): runs of TLC, mutants of its guards, traces of chaos."""
