"""The dock "Georeference": picked pairs, existing imagery and nudges give a map its place."""
