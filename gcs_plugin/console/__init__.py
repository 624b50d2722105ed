"""The operator's page in a browser: live video beside a map, orders by a tap, and the answer on the map."""
