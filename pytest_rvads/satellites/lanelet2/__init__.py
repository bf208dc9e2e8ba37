"""Maps made of lanelets: Lanelet2 files (``.osm``) and CommonRoad files (``.xml``)."""
