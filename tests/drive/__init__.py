"""An arm of MuJoCo that takes its session alone, led by `rsicalib guide --drive`."""
