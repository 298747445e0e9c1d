"""What several tests need: made scenes and folders, a browser, a cluster, places."""
