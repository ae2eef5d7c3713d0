"""The durable queues, kept by DBOS, which nothing outside this package knows.

DBOS remembers what was submitted through every crash and hands each job to one worker; what it
does not do is take over the jobs of a worker that died, so workers do (Queue.held and put_back),
and forget the ones that are done, so Queue.forget_done does.
"""
