"""Files in and out: tables, formats of others, KML."""
