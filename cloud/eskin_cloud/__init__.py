"""The cloud: takes in what gateways bring, keeps it, answers questions, and shows it live."""
