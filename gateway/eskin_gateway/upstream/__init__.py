"""HTTPS clients of the cloud, one a resource."""
