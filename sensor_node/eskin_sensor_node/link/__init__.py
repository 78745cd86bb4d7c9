"""The radio link: seal, send, and receive acknowledgements and commands."""
