"""REST service around the Adret library: uploads, jobs, results.

``create_app(settings)`` in :mod:`adret_service.app` builds the HTTP application,
:mod:`adret_service.worker` runs the jobs, and the two meet only in the database and the store.
"""
