"""From the spool to the cloud: send in order, retry, delete what the cloud confirmed."""
