"""The simulator ``sumo``: Eclipse SUMO runs in another process and drives the vehicles whose driver is `SumoDriver`."""
