"""Files of other people: what is read without a word, or asks for too much. See core.py for the fields."""
READERS, FEET = "tests/export/test_readers.py", "tests/export/test_character_feet.py"
TABLES, TORCH = "tests/robots/test_robot_tables.py", "tests/convert/test_torch_files.py"
POSING = "motion_jax/export/character/posing.py"

MUTATIONS = (
    ("readers-upward", "motion_jax/motion/plausibility.py", "alone = abs(rise[axis]) > 3 *",
     "alone = abs(rise[axis]) > 300 *",
     (f"{READERS}::test_a_body_that_lies_gets_a_note_with_the_flag_that_makes_it_stand",)),
    ("readers-sides", "motion_jax/motion/plausibility.py", "np.median(along) < -0.5 *", "np.median(along) > 0.5 *",
     (f"{READERS}::test_exchanged_sides_are_said",)),
    ("readers-milliseconds", "motion_jax/export/points.py", "rows[:, number] * unit", "rows[:, number]",
     (f"{READERS}::test_the_rate_of_a_table_is_that_of_its_times",)),
    ("readers-toes", "motion_jax/rigs/named_bodies.py", '("bigtoe", "toe",', '("thumb",',
     (f"{READERS}::test_markers_without_a_tree_have_head_and_toes_by_name",)),
    ("readers-full-disk", "motion_jax/export/points.py", "if not _is_whole(temporary)", "if False",
     ("tests/studio/cli/test_cli.py::test_a_full_disk_is_one_line",)),
    ("readers-decimal-comma", "motion_jax/utils/text_files.py", 'cell.replace(",", ".") if', "cell if",
     (f"{READERS}::test_tables_of_any_separator_and_spelling_are_read",)),
    ("readers-child-path", "motion_jax/data/mocap/child.py", "if os.path.isabs(folder)]", "if True]",
     ("tests/utils/test_stopping.py::test_a_child_runs_nothing_of_the_current_folder",)),
    ("readers-soles", POSING, "move[:, 1] = depth + clearance", "move[:, 1] = 0.08 + clearance",
     (f"{FEET}::test_soles_stand_on_the_floor_whatever_the_length_of_the_shoes",)),
    ("readers-stance", POSING, "move[:, [0, 2]] += _stance(", "move[:, [0, 2]] -= _stance(",
     (f"{FEET}::test_the_stance_is_as_broad_as_the_hips",)),
    ("readers-heading", "motion_jax/robots/retargeting.py",
     "start[3:7] = rot.multiply(rot.unit(yaw), start[3:7])", "pass",
     (f"{TABLES}::test_which_way_a_person_faces_changes_nothing_but_the_root",)),
    ("readers-in-the-floor", "motion_jax/robots/formats.py", "if lowest[best] < -_IN_THE_FLOOR and",
     "if False and",
     (f"{TABLES}::test_an_order_that_puts_the_body_into_the_floor_is_none",)),
    ("readers-repeated-tensors", "motion_jax/convert/torch_files.py", "if storage.left[0] < 0:", "if False:",
     (f"{TORCH}::test_sizes_that_cannot_be_are_refused",)),
    ("readers-wrappers", "motion_jax/convert/parts.py", "(?:(?:module|_orig_mod)", "(?:(?:module)",
     ("tests/convert/test_convert.py::test_wrappers_of_modules_are_taken_off_in_any_order",)),
    ("readers-linear-schedule", "motion_jax/models/mdm/weights.py", 'schedule=options["noise_schedule"]',
     'schedule="cosine"', ("tests/convert/test_convert_continuous.py::test_options_of_mdm_are_followed",)),
)
