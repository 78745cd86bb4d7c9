"""The emulated flash chip: encrypted records, each batch one synchronised commit."""
