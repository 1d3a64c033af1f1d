"""A pool of nodes that render one job together: ledger, rays between cells, films along the line (thesis B.4)."""
