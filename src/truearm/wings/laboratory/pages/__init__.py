"""The laboratory's pages and figures."""
