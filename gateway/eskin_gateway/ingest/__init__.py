"""From received messages to one durable commit: validate, encrypt, commit, acknowledge."""
