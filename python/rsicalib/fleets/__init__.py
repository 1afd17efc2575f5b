"""Many devices: one row of results each, by threads or by Dask."""
