"""The `taxel poking` paper: where 84 taxels of a forearm sit, from the wrenches of pokes."""
