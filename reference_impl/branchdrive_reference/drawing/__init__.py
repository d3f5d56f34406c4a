"""Pictures of branch groups: the map, the actors, and the futures that the candidates took."""
