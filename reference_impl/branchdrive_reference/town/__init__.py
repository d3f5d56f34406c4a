"""The map: roads as data, lanes and junctions built from them, routes, and the weather."""
