"""Evaluation, evaluators, metrics and utilities; see tools/mutate.py."""
DRAWS, PHYSICS = "tests/evaluation/test_test_set.py", "tests/metrics/test_physics.py"
HARNESS, CACHE = "tests/evaluation/test_harness.py", "tests/utils/test_cache.py"
FILES, TEXTS = "tests/utils/test_input_files.py", "tests/utils/test_text_files.py"
LEARNING, TWO_SAMPLE = "tests/evaluators/test_matching.py", "tests/metrics/test_two_sample.py"

MUTATIONS = (
    # --- what is drawn, sampled and kept --------------------------------------------------------------------------
    ("evaluation-coin", "motion_jax/evaluation/samples.py", "shorten < 1 / 3", "shorten < 2 / 3",
     (f"{DRAWS}::test_draws_are_spread_as_the_loaders_spread_them",)),
    ("evaluation-last-cut", "motion_jax/evaluation/samples.py", "(where * (rows - count + 1))",
     "(where * (rows - count))", (f"{DRAWS}::test_draws_are_spread_as_the_loaders_spread_them",)),
    ("evaluation-noise-of-copies", "motion_jax/evaluation/samples.py", "(seed, replication, item, copy))",
     "(seed, replication, item))", (f"{DRAWS}::test_draws_are_spread_as_the_loaders_spread_them",)),
    ("evaluation-samples-of-other-seeds", "motion_jax/evaluation/samples.py",
     'jobs.frames or file["seeds"].tolist() != jobs.seeds:', "jobs.frames:",
     (f"{DRAWS}::test_samples_know_all_code_that_made_them",)),
    ("evaluation-other-bones", "motion_jax/evaluation/external.py", "> _SAME_BONES or", "> 9 or",
     ("tests/evaluation/test_external.py::test_other_bones_and_floors_are_retargeted_as_those_of_real_motions",)),
    ("evaluation-zeros-after-the-end", "motion_jax/evaluation/external.py", "made = _as_real(x[:count], layout",
     "made = _as_real(x, layout",
     ("tests/evaluation/test_external.py::test_other_bones_and_floors_are_retargeted_as_those_of_real_motions",)),
    # --- what is judged -------------------------------------------------------------------------------------------
    ("evaluation-vector-of-fid", "motion_jax/evaluation/harness.py",
     "(embedded, generated, clip_generated, generated_for_fid)",
     "(embedded, generated, clip_generated)", (f"{HARNESS}::test_fid_is_of_what_stands_before_the_last_layer",)),
    ("evaluation-shuffled-pool", "motion_jax/evaluation/harness.py", "[first + rng.permutation(pool) for first",
     "[rng.permutation(pool) for first", (f"{HARNESS}::test_shuffled_captions_are_all_those_of_their_pools",)),
    ("evaluation-paired-fid", "motion_jax/evaluation/differences.py",
     "_gaussian(other[replication].generated[chosen])", "_gaussian(other[replication].made)",
     ("tests/evaluation/test_differences.py::test_a_row_does_not_differ_from_itself",)),
    ("evaluation-last-frame", "motion_jax/evaluators/networks.py", "padding_mask(num_frames + 1, x.shape[1])",
     "padding_mask(num_frames, x.shape[1])", ("tests/evaluators/test_evaluators.py",)),
    ("evaluation-gaussian-width", "motion_jax/evaluators/stages.py", "mean + jnp.exp(logvar / 2) *",
     "mean + jnp.exp(logvar) *", (f"{LEARNING}::test_the_loss_of_snapmogens_evaluator_is_the_formula",)),
    # --- numbers --------------------------------------------------------------------------------------------------
    ("evaluation-slide", "motion_jax/metrics/physics.py", "way = rot.length(_differences(feet, 1)[..., [0, 2]])",
     "way = rot.length(_differences(feet, 1)[..., [0, 1]])", (PHYSICS,)),
    ("evaluation-toes", "motion_jax/metrics/physics.py",
     "speed = rot.length(_differences(toes, 1)[..., [0, 2]])", "speed = rot.length(_differences(toes, 1))", (PHYSICS,)),
    ("evaluation-planted", "motion_jax/metrics/physics.py",
     "speed = rot.length(_differences(feet, 1)[..., [0, 2]])", "speed = rot.length(_differences(feet, 1))", (PHYSICS,)),
    ("evaluation-body-axes", "motion_jax/metrics/physics.py", "local[..., 0] * z - local[..., 2] * x",
     "local[..., 0] * z + local[..., 2] * x", (TWO_SAMPLE,)),
    ("evaluation-leaking-folds", "motion_jax/metrics/two_sample.py",
     "np.concatenate([real.clip, generated.clip]) % FOLDS", "np.arange(len(label)) % FOLDS", (TWO_SAMPLE,)),
    ("evaluation-last-border", "motion_jax/metrics/timeline_scores.py", "return inside[1:-1]", "return inside[1:]",
     ("tests/metrics/test_timeline_scores.py",)),
    # --- files ----------------------------------------------------------------------------------------------------
    ("evaluation-digest", "motion_jax/utils/cache.py",
     "magic == _MAGIC and hashlib.sha256(payload).digest() == digest", "magic == _MAGIC",
     (f"{CACHE}::test_what_is_damaged_is_not_read",)),
    ("evaluation-cache-bytes", "motion_jax/utils/cache.py", "if number >= MOST_FILES or number and total > MOST_BYTES:",
     "if number >= MOST_FILES:", (f"{CACHE}::test_the_oldest_files_go",)),
    ("evaluation-bomb", "motion_jax/utils/input_files.py", "_MAX_RATIO * min(packed, path.stat().st_size)",
     "_MAX_RATIO * packed", (f"{FILES}::test_a_bomb_stays_packed",)),
    ("evaluation-rows", "motion_jax/utils/text_files.py", "if len(rows) > _MOST_ROWS:", "if False:",
     (f"{TEXTS}::test_a_table_without_end_is_refused",)),
    ("evaluation-largest-text", "motion_jax/utils/text_files.py", "if size > largest:", "if False:",
     (f"{TEXTS}::test_a_text_of_too_many_bytes_is_not_read",)),
    ("evaluation-folder-mode", "motion_jax/utils/atomic.py", "folder.chmod(0o755)", "folder.chmod(0o700)",
     ("tests/utils/test_stopping.py::test_a_folder_that_replaces_another_is_there_at_every_moment",)),
)
