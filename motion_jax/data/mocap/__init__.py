"""Motion capture files: BVH, ASF and AMC."""
