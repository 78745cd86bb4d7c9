"""What every process needs: settings, logs, files, HTTP listeners."""
