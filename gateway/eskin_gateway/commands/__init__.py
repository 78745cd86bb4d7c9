"""Commands of the cloud: fetched, held until answered, published to their nodes."""
