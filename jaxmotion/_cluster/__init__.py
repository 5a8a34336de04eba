"""Work by other processes and machines, through dask: connections to a cluster, a stream of small
tasks, what runs on a worker. Nothing here imports JAX, for workers set it up first, or dask before
it is asked for."""
