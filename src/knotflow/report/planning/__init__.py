"""Plans in the report: their pictures, the tables of searches, and the pentagram's verdict."""
