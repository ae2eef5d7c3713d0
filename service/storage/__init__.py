"""Where photographs and results lie: a local folder or an S3-compatible store, by URL."""
