"""What tests ask for by ``@rvads.scenario`` and ``@rvads.recorded``, and its expansion into items at collection."""
