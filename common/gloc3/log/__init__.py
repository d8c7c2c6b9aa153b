"""The data log (DESIGN §10): MCAP files that are written crash-safe, read although damaged, drawn and replayed."""
