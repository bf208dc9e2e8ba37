"""The marks ``@rvads.scenario`` and ``@rvads.recorded``, and their expansion into test items when pytest collects the tests."""
