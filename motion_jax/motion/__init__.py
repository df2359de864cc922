"""What a motion is, without any learning: skeletons, rotations, features, statistics, retargeting."""
