"""Breaks of what trains, saves and opens runs: motion_jax/training, runs.py, fit.py, loading.py and configs."""
BUDGET, GUARDS, OPTIMIZERS, START = (f"tests/training/test_{name}.py" for name in (
    "budget", "guards", "optimizers", "train_start"))
RUNS = "tests/test_runs.py"
RECIPES, FACTS = (f"tests/configs/test_{name}.py" for name in ("shipped_recipes", "config_facts"))
OPENED = "tests/test_damaged_runs.py::test_raw_weights_and_another_text_encoder_are_opened_where_they_are_given"

MUTATIONS = (
    ("training-deadline-left", "motion_jax/training/budget.py", "return step if left > cooldown else",
     "return step if left > 2 * cooldown else", (f"{BUDGET}::test_a_deadline_leaves_time_for_the_cooldown",)),
    ("training-rollback-refunds", "motion_jax/training/budget.py", "self._spent = max(self._spent, spent)",
     "self._spent = spent", (f"{BUDGET}::test_a_saved_count_is_taken_over_and_a_rollback_gives_nothing_back",)),
    ("training-linear-after-warm-up", "motion_jax/training/optimizers.py",
     "config.final_rate / peak, max(num_steps - warmup, 1), warmup)", "config.final_rate / peak, num_steps, 0)",
     (f"{OPTIMIZERS}::test_schedules_by_name",)),
    ("training-released-warm-up", "motion_jax/training/optimizers.py", "jnp.minimum(step + 2, warmup)",
     "jnp.minimum(step + 1, warmup)", (f"{OPTIMIZERS}::test_schedules_by_name",)),
    ("training-rate-below-a-name", "motion_jax/training/optimizers.py", "update * _rate(path, rates)",
     "update / _rate(path, rates)", (f"{OPTIMIZERS}::test_parts_are_clipped_and_rated_by_name",)),
    ("training-clip-parts", "motion_jax/training/optimizers.py", '| {"rest": optax.identity()}', '| {"rest": clip}',
     (f"{OPTIMIZERS}::test_parts_are_clipped_and_rated_by_name",)),
    ("training-spike-history", "motion_jax/training/train_step.py", "jnp.append(norms[1:], jnp.where",
     "jnp.append(state.norms[:-1], norm)", (
         f"{GUARDS}::test_a_spike_of_the_gradient_is_told_and_left_out_where_the_config_says_so",)),
    ("training-part-of-a-step", "motion_jax/training/train_step.py", "jnp.add, found, of_rows(rows))",
     "jnp.maximum, found, of_rows(rows))", (
         "tests/training/test_train.py::test_a_batch_in_parts_is_one_step_and_goes_on_with_or_without",)),
    ("training-epoch-counts-whole-batches", "motion_jax/training/setup.py",
     "resolved.train.num_steps = epochs * max(num_items // config.data.batch_size, 1)",
     "resolved.train.num_steps = epochs * max(-(-num_items // config.data.batch_size), 1)",
     (f"{FACTS}::test_steps_come_from_epochs_and_the_number_of_items",)),
    ("training-other-std", "motion_jax/training/setup.py", "or not np.allclose(before.std, stats.std, rtol=0.01)",
     "or False", ("tests/test_smoke.py::test_resume_with_other_frozen_parts_is_refused",)),
    ("training-other-words", "motion_jax/training/setup.py",
     'if known is not None and known != json.loads(files[checkpoint.TEXT])["fingerprint"]:', "if False:",
     ("tests/test_smoke.py::test_resume_with_other_frozen_parts_is_refused",)),
    ("training-fit-of-another-layout", "motion_jax/fit.py", "if features != layout.dim:", "if features > layout.dim:",
     (f"{RUNS}::test_a_network_of_another_width_than_the_layout_is_refused",)),
    ("training-share-of-a-pass", "motion_jax/fit.py", 'config.get("seconds", 0.0) * one.get("share", 0)',
     'config.get("seconds", 0.0)', (f"{RECIPES}::test_the_passes_of_a_recipe_fit_each_other",)),
    ("training-exchanged-encoder", "motion_jax/runs.py", '(given["encoder"], own["encoder"])))):',
     '(given["encoder"], given["encoder"])))):',
     (f"{START}::test_a_new_decoder_goes_to_the_generator_of_its_latents",)),
    ("training-parameters-left-out", "motion_jax/runs.py", 'if name.partition("/")[0] in SAMPLED)', ")",
     ("tests/test_shipped_models.py::test_parameters_are_counted_in_one_way",)),
    ("training-text-of-the-run", "motion_jax/loading.py", "load_text_encoder(text or run.text,",
     "load_text_encoder(run.text,", (OPENED,)),
    ("training-raw-weights", "motion_jax/loading.py", "tuple(registry.model_stages()), raw)",
     "tuple(registry.model_stages()))", (OPENED,)),
)
