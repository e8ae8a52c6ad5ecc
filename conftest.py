"""Options of the test suite, and how its tests are shared among workers."""

import os
import signal
import sys
from collections import Counter

import pytest

# A shell that starts the tests in the background has Ctrl-C ignored, and so it would be in all that tests start.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Hundreds of processes are started, each of which would compile every module anew, and pytest every test.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# Every state that a test asks for is solved, and nothing is put into the store of the user.
os.environ["POROCORE_STORE"] = "none"

#: Scopes that share what is expensive to set up, or that must not run side by side: each is done by one worker.
TOGETHER = {
    # Every process in which jax compiles keeps gigabytes; what one test compiles, the next one finds.
    "jax": ("plugins/surrogate_jax/", "tests/consistency/test_surrogate"),
    # Built once, and one environment with gigabytes of libraries for all that look into it.
    "distributions": ("tests/release/",),
    # One finished run for all of them; and on two cores two MPI runs of two processes would wait for one another.
    "finished run": (
        "tests/e2e/test_damaged.py",
        "tests/e2e/test_disks.py",
        "tests/e2e/test_kills.py",
        "tests/e2e/test_mpi.py",
        "tests/e2e/test_physics.py",
        "tests/e2e/test_python.py",
        "tests/e2e/test_refusals.py",
        "tests/e2e/test_run.py",
        "tests/e2e/test_side_by_side.py",
        "plugins/fem_dolfinx/tests/test_macro_mpi.py",
    ),
}
#: Begun first, so that no worker is left with a long one at the end.
LONG = ("jax", "finished run", "tests/docs/test_snippets", "plugins/", "tests/consistency/", "tests/e2e/")


#: Beginnings of the reasons for which a test may be skipped where everything is installed: it is for the slow suite, or
#: the machine lacks what cannot be installed.
GOOD_REASONS = (
    "slow;",
    "torch sees no GPU",
    "a small disk cannot be mounted here",
    "there is no 'unshare' here",
)
#: What an implementation need not offer: reasons from the kit, and from tests that compare what only some offer.
OFFERED_BY_SOME = ("porocore/testing/", "gives no access to its tangent")


_CELL_LAWS = "plugins/fem_dolfinx/tests/test_conformance.py::TestDolfinxCellSolver::test_"
_CONTACT_LAWS = "plugins/fem_dolfinx/tests/test_contact.py::TestDolfinxCellContact::test_"
_BY_DEFAULT = (
    "it_learns_what_it_offers",
    "the_undeformed_cell_is_exact",
    "the_trained_range_is_the_same_for_all",
    "it_knows_what_it_was_trained_on",
    "it_serves_a_closure",
)
_MACRO_LAWS = "plugins/fem_dolfinx/tests/test_macro.py::TestDolfinxMacroSolver::test_"
#: What the slow suite keeps although the rest of its class or table is fast: whole cells of the second backend,
#: which tests/consistency holds to the first, variants of one model, and what a shorter test looks at, too.
SLOW = (
    f"{_CELL_LAWS}objectivity",
    f"{_CELL_LAWS}a_rotation_of_the_body_rotates_the_flux",
    f"{_CELL_LAWS}shear_derivatives_of_a_diagonal_state",
    f"{_CELL_LAWS}rows_do_not_depend_on_the_batch_or_its_order",
    f"{_CELL_LAWS}derivatives_match_differences",
    f"{_CELL_LAWS}each_variable_alone_changes_the_answer[H]",
    f"{_CELL_LAWS}eighth_and_whole_cell_agree",
    f"{_CELL_LAWS}the_flow_percolates_along_every_axis",
    f"{_CELL_LAWS}a_strain_of_one_percent_is_no_overlap",
    f"{_CELL_LAWS}two_calls_give_the_same_to_the_last_bit",
    f"{_CELL_LAWS}a_new_solver_gives_the_same",
    f"{_CONTACT_LAWS}stress_and_fluid_volume_derive_from_the_potential",
    f"{_CONTACT_LAWS}the_stiffness_hardly_matters",
    # Steps and checkpoints are the core's, and scikit-fem obeys these laws in the fast suite.
    f"{_MACRO_LAWS}failed_steps_are_halved_to_the_same_answer",
    f"{_MACRO_LAWS}time_steps_converge_with_order_one",
    f"{_MACRO_LAWS}steps_by_error_meet_the_tolerance",
    f"{_MACRO_LAWS}a_killed_run_continues_to_the_identical_solution[0.5]",
    f"{_MACRO_LAWS}a_killed_run_continues_to_the_identical_solution[4.2]",
    f"{_MACRO_LAWS}foreign_and_damaged_checkpoints_are_refused",
    f"{_MACRO_LAWS}a_truncated_checkpoint_is_refused",
    f"{_MACRO_LAWS}a_checkpoint_of_another_problem_or_law_is_refused",
    # The fast suite turns the flux of the undeformed pore, and the state of the deformed one in test_objectivity.
    "plugins/fem_skfem/tests/test_conformance.py::TestSkfemCellSolver::test_a_rotation_of_the_body_rotates_the_flux[d",
    # One backend of two, one library of two, or one load of several stays in the fast suite.
    "plugins/fem_dolfinx/tests/test_memory.py::test_preparations_give_back_what_they_take",
    "plugins/fem_dolfinx/tests/test_macro.py::TestDolfinxMacroSolver::test_a_killed_run_continues_to_the_identical_history",
    "plugins/fem_dolfinx/tests/test_macro.py::test_a_singular_matrix_ends_in_one_message[field split]",
    "plugins/fem_dolfinx/tests/test_macro_mpi.py::test_more_processes_than_elements_can_be_shared_among_are_refused",
    "plugins/fem_skfem/tests/test_cell.py::test_statuses_under_strong_compression[0.0]",
    "plugins/fem_skfem/tests/test_conformance.py::TestSkfemCellSolver::test_eighth_and_whole_cell_agree[stretched]",
    # The command is asked for the same state in tests/e2e/test_cell.py.
    "plugins/fem_skfem/tests/test_cell.py::test_suction_ends_in_a_status",
    "plugins/surrogate_jax/tests/test_conformance.py::TestMlp::test_training_is_seeded",
    "plugins/surrogate_jax/tests/test_conformance.py::TestPotential::test_training_is_seeded",
    # The loops of training are the core's; the fast suite has them with torch.
    "plugins/surrogate_jax/tests/test_conformance.py::TestMlp::test_resumed_training_equals_an_uninterrupted_one",
    "plugins/surrogate_jax/tests/test_conformance.py::TestMlp::test_a_file_that_was_moved_is_enough",
    "plugins/surrogate_jax/tests/test_conformance.py::TestPotential::test_what_is_not_resumable_leaves_no_checkpoint",
    "plugins/surrogate_jax/tests/test_surrogate.py::test_the_papers_network_learns_the_map",
    "plugins/surrogate_jax/tests/test_surrogate.py::test_what_is_trained_is_what_is_evaluated[tanh]",
    "plugins/surrogate_jax/tests/test_surrogate.py::test_the_best_weights_are_kept_and_patience_ends_the_training",
    "plugins/surrogate_jax/tests/test_surrogate.py::test_a_finished_training_is_not_repeated",
    "plugins/surrogate_jax/tests/test_surrogate.py::test_a_checkpoint_of_other_options_is_refused",
    "tests/combinations/test_combinations.py::test_short_rows[wedge-plate]",
    "tests/consistency/test_cells.py::test_statuses_agree_under_strong_compression[dolfinx-skfem-frictionless-contact]",
    "tests/consistency/test_cells.py::test_identities[dolfinx",
    "tests/consistency/test_expected.py::test_a_backend_that_does_not_load_fails_where_all_should_be[-skipped]",
    "tests/consistency/test_contact.py::test_the_kind_of_wall_changes_the_answer_only_beyond_the_crease[dolfinx]",
    "tests/consistency/test_stability.py::test_pivots_and_eigenvalues[dolfinx-skfem-open]",
    # Networks of default size. What they offer, know and flag is held to the laws of the kit on shorter trainings, and
    # plugins/surrogate_torch trains the paper's network.
    *(
        f"tests/consistency/test_surrogates.py::test_{law}[{name}"
        for law in _BY_DEFAULT
        for name in ("jax", "torch")
    ),
    "tests/consistency/test_surrogates.py::test_two_agree_within_their_errors",
    # One of each library, activation and model stays.
    "tests/consistency/test_surrogate_libraries.py::test_a_network_of_given_weights[2-hidden0-sigmoid-jax",
    "tests/consistency/test_surrogate_libraries.py::test_a_network_of_given_weights[2-hidden0-tanh-jax",
    "tests/consistency/test_surrogate_libraries.py::test_a_network_of_given_weights[7-hidden1-sigmoid-jax",
    "tests/consistency/test_surrogate_libraries.py::test_a_network_of_given_weights[7-hidden1-tanh-jax",
    "tests/consistency/test_surrogate_libraries.py::test_a_file_written_by_one_is_read_by_all[jax-potential ",
    "tests/consistency/test_surrogate_libraries.py::test_a_file_written_by_one_is_read_by_all[jax-cubic",
    "tests/consistency/test_surrogate_libraries.py::test_a_file_written_by_one_is_read_by_all[jax-mlp of tanh",
    "tests/consistency/test_surrogate_libraries.py::test_a_file_written_by_one_is_read_by_all[torch-mlp of tanh",
    "tests/consistency/test_surrogate_libraries.py::test_a_file_written_by_one_is_read_by_all[torch-cubic",
    "tests/consistency/test_surrogate_libraries.py::test_the_same_training_of_a_potential[two]",
    # Families: torch obeys these laws in the fast suite; jax keeps the slopes by parameters.
    "tests/consistency/test_surrogate_libraries.py::test_the_same_training_of_a_potential[family]",
    *(
        f"plugins/surrogate_jax/tests/test_conformance.py::TestPotential::test_{law}"
        for law in ("every_member_is_exact_at_rest", "learns_every_member", "a_saved_family_is_the_same")
    ),
    "plugins/surrogate_jax/tests/test_conformance.py::TestMlpWithTanh::",
    "plugins/surrogate_jax/tests/test_conformance.py::TestPotentialOnPolynomial::",
    # Their commands have fast tests of their own in tests/verification, and the Python of the last runs in tests/e2e.
    "tests/docs/test_snippets.py::test_the_snippets_of_a_page_run[docs/sensitivity.md]",
    "tests/docs/test_snippets.py::test_the_snippets_of_a_page_run[docs/verification.md]",
    "tests/docs/test_snippets.py::test_the_snippets_of_a_page_run[docs/python.md]",
    # The longest pages. Of their commands tune, train, report, schema, reproduce and data stand on no fast page as they
    # are written here; what they do has fast tests of its own, and so have dask's workers in tests/sampling.
    "tests/docs/test_snippets.py::test_the_snippets_of_a_page_run[docs/tour.md]",
    "tests/docs/test_snippets.py::test_the_snippets_of_a_page_run[docs/cluster.md]",
    "tests/docs/test_snippets.py::test_the_snippets_of_a_page_run[docs/crosscheck.md]",
    "tests/docs/test_snippets.py::test_the_snippets_of_a_page_run[docs/cell.md]",
    "tests/docs/test_snippets.py::test_the_snippets_of_a_page_run[docs/conductivity.md]",
    # Their plugins pass their own tests in tests/plugins, where they are made, installed and checked, too.
    "tests/docs/test_snippets.py::test_the_snippets_of_a_page_run[docs/plugin-tutorial.md]",
    "tests/docs/test_snippets.py::test_the_snippets_of_a_page_run[examples/plugins/",
    "tests/e2e/test_kills.py::test_a_run_killed_in_every_stage_ends_with_the_same_numbers",
    # Variants of what stays: another executor, sampler, body, model or page of several.
    "plugins/fem_dolfinx/tests/test_contact.py::TestDolfinxCellContact::test_derivatives_match_differences",
    "plugins/fem_dolfinx/tests/test_macro_multigrid.py::test_the_iteration_agrees_with_the_factor[frames, a plate",
    "plugins/fem_skfem/tests/test_kept_factors.py::test_results_do_not_depend_on_the_widened_patterns_that_are_kept",
    "plugins/fem_skfem/tests/test_multigrid.py::test_multigrid_gives_the_response_of_a_factor[channels-quadratic-curved]",
    "plugins/fem_skfem/tests/test_multigrid.py::test_a_cycle_is_symmetric_and_as_good_on_a_finer_mesh[whole]",
    "plugins/surrogate_jax/tests/test_surrogate.py::test_a_network_on_a_polynomial_improves_on_it",
    "plugins/surrogate_jax/tests/test_evaluator.py::test_jit_against_eager[sigmoid]",
    "plugins/surrogate_jax/tests/test_conformance.py::TestPotential::test_resumed_training_equals_an_uninterrupted_one",
    "plugins/surrogate_jax/tests/test_conformance.py::TestPotential::test_a_file_that_was_moved_is_enough",
    "plugins/surrogate_torch/tests/test_conformance.py::TestMlpWithTanh::test_training_is_seeded",
    "plugins/surrogate_torch/tests/test_conformance.py::TestPotentialOnPolynomial::test_a_file_that_was_moved_is_enough",
    "tests/consistency/test_surrogate_libraries.py::test_a_file_written_by_one_is_read_by_all[torch-mlp]",
    "tests/consistency/test_surrogate_libraries.py::test_a_file_written_by_one_is_read_by_all[jax-mlp]",
    "tests/consistency/test_surrogate_libraries.py::test_a_file_written_by_one_is_read_by_all[torch-potential without",
    "plugins/fem_skfem/tests/test_rotations.py::test_derivatives_are_those_of_each_load_alone[curved-material1-amg",
    "plugins/surrogate_torch/tests/test_conformance.py::TestMlpWithTanh::test_resumed_training_equals",
    "tests/docs/test_snippets.py::test_the_snippets_of_a_page_run[docs/representative-volume.md]",
    "tests/docs/test_snippets.py::test_the_snippets_of_a_page_run[docs/plugins.md]",
    "tests/e2e/test_kills.py::test_ctrl_c_while_sampling_keeps_what_ran_and_says_how_to_go_on",
    "tests/e2e/test_side_by_side.py::test_files_and_words_are_those_of_one_after_the_other",
    "tests/e2e/test_side_by_side.py::test_what_is_there_stays_and_is_told_in_order",
    "tests/e2e/test_side_by_side.py::test_killed_with_its_processes_at_work_it_goes_on",
    "tests/e2e/test_side_by_side.py::test_stopped_while_training_runs_beside_the_held_out_states",
    "tests/report/test_report.py::test_figures_drawn_in_processes_are_the_same_bytes",
    "tests/testing/test_partial_plugins.py::test_what_it_offers_passes_and_the_rest_is_skipped_and_said[TestColumn]",
    "tests/e2e/test_disks.py::test_a_disk_that_fills_while_sampling[serial]",
    "tests/e2e/test_examples.py::test_confined_compression_relaxes",
    "tests/plugins/test_plugin_projects.py::test_an_example_plugin_passes_its_tests[porocore-surrogate-gaussian",
    "tests/plugins/test_plugin_projects.py::test_an_example_plugin_passes_its_tests[porocore-sampler-halton]",
    "tests/sampling/test_campaign_kills.py::test_killed_and_resumed[1-2]",
    "tests/sampling/test_execution.py::test_two_workers_give_the_same_bits_and_prepare_the_cell_once_each[40-",
    "tests/sampling/test_sampling_learning.py::test_five_thousand_asks_in_ten_dimensions_cost_the_same_each",
    "tests/sampling/test_sampling_resumed.py::test_killed_anywhere_and_resumed[MacroDriven]",
    "tests/study/test_store_users.py::test_a_second_study_solves_nothing[_sensitivity-2]",
    "tests/study/test_tune.py::test_another_run_on_the_same_samples_trains_none_again",
    "tests/study/test_tune.py::test_a_search_that_is_interrupted_goes_on",
    "tests/surrogates/test_surrogate_symmetry.py::test_a_potential_with_this_group_is_recovered[trigonal]",
    "tests/surrogates/test_surrogate_symmetry.py::test_a_potential_with_this_group_is_recovered[monoclinic]",
    # The longest of what shorter tests of the same piece look at, too: the user's store is held to its laws in
    # tests/core, tests/study and tests/sampling, processes beside each other in tests/core; CI builds the site.
    "tests/docs/test_site.py::",
    "tests/docs/test_snippets.py::test_the_snippets_of_a_page_run[docs/start.md]",
    "tests/docs/test_snippets.py::test_the_snippets_of_a_page_run[docs/install.md]",
    "tests/e2e/test_store.py::test_a_study_with_another_body_solves_no_cell_and_trains_nothing",
    "tests/e2e/test_store.py::test_a_damaged_store_gives_the_same_answer",
    "tests/e2e/test_side_by_side.py::test_a_run_whose_stages_overlap_has_the_files_and_words_of_another",
    "tests/e2e/test_side_by_side.py::test_a_process_that_dies_ends_the_run_with_its_checkpoint",
    "tests/e2e/test_disks.py::test_a_read_only_folder",
    "tests/e2e/test_kills.py::test_ctrl_c_later_on[solve]",
    "tests/e2e/test_stability.py::test_the_onset_of_period_two_comes_before_that_of_one_and_later_under_pressure",
    "tests/cell/test_boxes.py::test_the_eighth_of_a_box_answers_like_the_whole[dolfinx]",
    "tests/cell/test_image_agreement.py::test_what_smoothing_closes_asks_for_less_smoothing",
    "tests/cell/test_image_agreement.py::test_small_closed_pieces_are_told_by_what_they_cost_and_with_no_advice",
    "tests/cell/test_image_specks.py::test_a_speck_that_comes_loose_in_the_mesh_is_dropped_with_the_grains[mirror]",
    "tests/consistency/test_stability.py::test_pivots_and_eigenvalues[dolfinx-skfem-contact]",
    "tests/consistency/test_surrogate_libraries.py::test_the_same_training_of_a_potential[all]",
    "tests/macro/test_adaptive.py::test_the_first_step_after_each_bend_meets_the_tolerance[0.0001]",
    "tests/plugins/test_plugin_projects.py::test_new_and_check_by_the_command",
    "tests/sampling/test_campaign_kills.py::test_one_ctrl_c_gives_up_states_that_take_long[1]",
    "tests/sampling/test_plain_scripts.py::test_a_plain_script_runs_once[stdin]",
    "tests/sampling/test_sampling_resumed.py::test_killed_anywhere_and_resumed[Active]",
    "tests/sampling/test_solved_store.py::test_what_is_taken_tells_nothing_about_the_time_left",
    "tests/sampling/test_warm_starts.py::test_a_start_in_vain_is_made_from_rest",
    "tests/sampling/test_warm_starts.py::test_where_walls_begin_to_touch_the_path_is_that_from_rest",
    "tests/study/test_at_rest.py::test_a_pore_size_that_is_off_by_ten_is_seen",
    "tests/study/test_preflight.py::test_check_notes_drained_surfaces_that_no_pore_leads_to",
    "tests/study/test_preflight.py::test_check_refuses_a_cell_whose_fluid_cannot_follow[block]",
    "tests/study/test_resolution.py::test_elements_are_counted_by_their_real_edge",
    "tests/verification/test_representative_volume.py::test_cells_come_from_the_store",
    f"{_CELL_LAWS}each_variable_alone_changes_the_answer[p]",
    f"{_CELL_LAWS}an_overlap_has_no_values",
    f"{_MACRO_LAWS}the_tangent_is_the_derivative_of_the_residual_on_any_body[tetrahedra]",
    "plugins/surrogate_torch/tests/test_conformance.py::TestPotential::test_training_is_seeded",
    "plugins/surrogate_torch/tests/test_conformance.py::TestPotential::test_a_file_that_was_moved_is_enough",
    "plugins/surrogate_torch/tests/test_conformance.py::TestPotentialOnPolynomial::test_training_is_seeded",
    "tests/verification/test_local_fields.py::test_pictures_are_drawn_without_a_display",
    # Second backend and variants, once more. Slopes and members: scikit-fem obeys these laws in the fast suite, and
    # tests/consistency holds the slopes of dolfinx to differences. Newton, checkpoints and the loop over states are the
    # core's. Each backend keeps a wedge and tetrahedra, a follower, and the histories of the other one.
    f"{_CELL_LAWS}slopes_are_there",
    f"{_CELL_LAWS}slopes_of_the_hessian_at_rest",
    f"{_CELL_LAWS}slopes_match_differences",
    f"{_CELL_LAWS}a_failed_state_does_not_take_the_others_along",
    f"{_CELL_LAWS}inputs_are_not_changed",
    f"{_CELL_LAWS}a_start_changes_the_way_and_not_the_answer",
    f"{_CELL_LAWS}conductivity_of_the_deformed_pore",
    f"{_CONTACT_LAWS}a_wall_that_gives_way_overlaps",
    f"{_CONTACT_LAWS}a_start_in_contact_changes_the_way_and_not_the_answer",
    f"{_MACRO_LAWS}the_promise_of_a_constant_tangent_changes_no_answer",
    f"{_MACRO_LAWS}a_finished_run_is_not_run_again",
    f"{_MACRO_LAWS}checkpoints_wait_for_their_time",
    f"{_MACRO_LAWS}a_law_that_answers_differently_under_the_same_name_is_refused",
    f"{_MACRO_LAWS}axial_stress_is_uniform",
    f"{_MACRO_LAWS}pressure_converges_with_the_square_of_the_element_size",
    f"{_MACRO_LAWS}share_outside_the_trained_range_is_a_volume",
    f"{_MACRO_LAWS}a_small_load_gives_linear_poroelasticity[-1e-06]",
    f"{_MACRO_LAWS}the_tangent_is_the_derivative_of_the_residual_on_any_body[quarter-cylinder]",
    f"{_MACRO_LAWS}fields_of_first_order_are_exact_on_any_body[quarter-cylinder]",
    f"{_MACRO_LAWS}fields_of_first_order_are_exact_on_any_body[wedge]",
    f"{_MACRO_LAWS}probes_say_what_the_fields_say[wedge]",
    f"{_MACRO_LAWS}reactions_balance_the_loads[tetrahedra]",
    f"{_MACRO_LAWS}a_pushed_plate_is_a_face_moved_by_as_much",
    "plugins/fem_dolfinx/tests/test_macro_multigrid.py::test_iterations_do_not_grow_over_eight_decades_of_time_steps[uniform]",
    "plugins/fem_dolfinx/tests/test_macro_multigrid.py::test_the_iteration_agrees_with_the_factor[block-linear]",
    "plugins/fem_dolfinx/tests/test_form_cache.py::test_forms_are_kept_apart_from_those_of_other_programs",
    "plugins/fem_skfem/tests/test_rotations.py::test_derivatives_are_those_of_each_load_alone[curved-material1-pardiso",
    "plugins/fem_skfem/tests/test_multigrid.py::test_multigrid_gives_the_response_of_a_factor[gyroid-quadratic-curved]",
    "plugins/fem_skfem/tests/test_multigrid.py::test_stokes_flow_by_iteration_is_that_by_factors[channels]",
    "plugins/fem_skfem/tests/test_iterative.py::test_a_march_ends_as_with_factors[moved-nonlinear]",
    "plugins/fem_skfem/tests/test_cell.py::test_published_values_of_the_cell[0.2-",
    "tests/consistency/test_cell_kinds.py::test_backends_agree[dolfinx-skfem-gyroid-",
    "tests/consistency/test_contact.py::test_averages_and_derivatives_agree_in_contact[dolfinx-skfem-under pressure]",
    "tests/consistency/test_cells.py::test_averages_and_derivatives_agree[dolfinx-skfem-quadratic-straight-auto]",
    "tests/consistency/test_cells.py::test_conductivities_agree[dolfinx-skfem-linear-none]",
    "tests/consistency/test_conductivity.py::test_at_rest_it_is_that_of_the_undeformed_cell[dolfinx-channel]",
    "tests/consistency/test_layered.py::test_all_responses_and_derivatives[with fluid-squeezed-dolfinx]",
    "tests/consistency/test_layered.py::test_all_responses_and_derivatives[two solids-squeezed-dolfinx]",
    "tests/cell/test_supercell.py::test_a_stable_supercell_answers_like_one_cell[dolfinx]",
    "tests/cell/test_boxes.py::test_a_cell_repeated_along_an_axis_answers_like_the_cell[dolfinx]",
    "tests/cell/test_image_agreement.py::test_every_neck_of_less_than_two_elements_is_told_with_one_width_and_one_advice[0.065]",
    "tests/cell/test_image_agreement.py::test_every_neck_of_less_than_two_elements_is_told_with_one_width_and_one_advice[0.08]",
    # One network of each library, activation and model stays.
    "plugins/surrogate_jax/tests/test_conformance.py::TestPotential::test_saved_and_loaded_it_is_the_same",
    "plugins/surrogate_jax/tests/test_evaluator.py::test_jit_against_eager[tanh]",
    "plugins/surrogate_torch/tests/test_conformance.py::TestMlpWithTanh::test_saved_and_loaded_it_is_the_same",
    "plugins/surrogate_torch/tests/test_conformance.py::TestMlpWithTanh::test_a_file_that_was_moved_is_enough",
    "plugins/surrogate_torch/tests/test_conformance.py::TestPotential::test_what_is_not_resumable_leaves_no_checkpoint",
    "tests/consistency/test_surrogate_libraries.py::test_a_network_of_given_weights[7-hidden1-softplus-jax",
    "tests/consistency/test_surrogate_libraries.py::test_a_file_written_by_one_is_read_by_all[torch-potential]",
    "tests/surrogates/test_surrogate_symmetry.py::test_a_potential_with_this_group_is_recovered[triclinic]",
    # One of several processes that end alike. Ctrl-C while sampling: tests/e2e/test_kills.py; bad offers of plugins:
    # tests/plugins/test_bad_offers.py; the same states in another process: the active and the macro-driven sampler.
    "tests/sampling/test_campaign_kills.py::test_interrupted_with_ctrl_c[1]",
    "tests/sampling/test_sampling_laws.py::TestLatinHypercube::test_another_process_asks_for_the_same_states",
    "tests/sampling/test_sampling_laws.py::TestSobol::test_another_process_asks_for_the_same_states",
    "tests/sampling/test_sampling_resumed.py::test_a_damaged_record_is_made_again[_binary]",
    "tests/sampling/test_sampling_resumed.py::test_a_damaged_record_is_made_again[_of_another_kind]",
    "tests/plugins/test_installed_plugins.py::test_who_asks_for_one_is_told_what_is_wrong_with_it[misspelt hook]",
    "tests/plugins/test_installed_plugins.py::test_who_asks_for_one_is_told_what_is_wrong_with_it[another interface]",
    "tests/plugins/test_installed_plugins.py::test_who_asks_for_one_is_told_what_is_wrong_with_it[missing dependency]",
    "tests/test_skips.py::test_a_skip_fails_in_ci_unless_it_is_a_good_one[slow]",
    # Families of cells: torch keeps the laws of networks, the polynomial those of sweeps, scikit-fem those of slopes at
    # rest; tests/study/test_sweep.py and tests/cli have the commands of the page on parameters.
    "plugins/surrogate_jax/tests/test_conformance.py::TestPotential::test_a_cell_with_parameters_is_learned",
    "plugins/surrogate_jax/tests/test_conformance.py::TestPotential::test_the_order_of_the_parameters_is_that_of_the_inputs",
    "tests/consistency/test_surrogate_libraries.py::test_a_file_written_by_one_is_read_by_all[jax-family",
    "tests/consistency/test_surrogate_libraries.py::test_a_file_written_by_one_is_read_by_all[torch-family without",
    "tests/docs/test_snippets.py::test_the_snippets_of_a_page_run[docs/parameters.md]",
    "tests/study/test_sweep.py::test_moved_surfaces_several_loads_and_units",
    "tests/study/test_sweep.py::test_processes_side_by_side_give_the_same",
    f"{_CELL_LAWS}a_member_is_the_cell_with_its_numbers",
    # What a shorter test of the same piece looks at, too: Ctrl-C in tests/e2e/test_kills.py, runs without a store in
    # tests/study, regions in tests/study/test_layers_of_cells.py, crosschecks by their verdicts.
    "tests/e2e/test_side_by_side.py::test_an_interruption_keeps_checkpoints_and_times",
    "tests/e2e/test_store.py::test_no_store_is_neither_read_nor_filled",
    "tests/testing/test_partial_plugins.py::test_what_it_offers_passes_and_the_rest_is_skipped_and_said[TestKernels]",
    "tests/consistency/test_surrogate_libraries.py::test_a_file_written_by_one_is_read_by_all[jax-potential]",
    "tests/consistency/test_surrogate_libraries.py::test_a_file_written_by_one_is_read_by_all[torch-potential on",
    f"{_MACRO_LAWS}fields_of_first_order_are_exact_on_any_body[tetrahedra]",
    "plugins/surrogate_torch/tests/test_conformance.py::TestMlp::test_training_is_seeded",
    "plugins/surrogate_jax/tests/test_evaluator.py::test_jit_against_eager[softplus]",
    "tests/consistency/test_cell_kinds.py::test_backends_agree[dolfinx-skfem-image-",
    "tests/consistency/test_slopes.py::test_slopes_of_the_solid_on_the_eighth[dolfinx-quadratic-curved]",
    "tests/verification/test_crosscheck.py::test_when_the_first_backend_cannot_sample_the_next_one_does",
    "tests/report/test_report.py::test_pyplot_is_not_used",
    "tests/sampling/test_campaign_kills.py::test_a_worker_that_dies_twice_over_a_state_costs_that_state_only[2]",
    "tests/study/test_family_workers.py::test_the_same_member_of_another_family_is_solved_again_for_its_slopes",
    "tests/verification/test_representative_volume.py::test_sub_volumes_of_whole_periods_are_the_cell",
    "plugins/fem_dolfinx/tests/test_form_cache.py::test_two_processes_may_compile_the_same_form_at_once",
    "plugins/fem_dolfinx/tests/test_macro.py::test_a_field_split_gives_the_same_history",
    "tests/consistency/test_layered.py::test_all_responses_and_derivatives[with fluid-sheared-dolfinx]",
    "tests/consistency/test_planes.py::test_backends_agree[dolfinx-skfem-oblique-small]",
    "tests/consistency/test_contact.py::test_walls_that_touch_agree_under_shear[dolfinx-skfem]",
    f"{_CONTACT_LAWS}says_so",
    # Killed and resumed: tests/e2e/test_kills.py and the resumed samplers.
    "tests/sampling/test_campaign_kills.py::test_killed_and_resumed[0-1]",
    "tests/consistency/test_swelling_bodies.py::test_a_pulse_of_swelling_relaxes_as_the_linear_theory_says[skfem-linear]",
    f"{_MACRO_LAWS}the_tangent_is_the_derivative_of_the_residual_on_any_body[wedge]",
    "tests/study/test_layers_of_cells.py::test_regions_of_equal_cells_are_the_plain_study",
    "plugins/surrogate_jax/tests/test_conformance.py::TestMlp::test_saved_and_loaded_it_is_the_same",
    "tests/cell/test_supercell.py::test_behind_the_onset_a_supercell_follows_the_mode_of_period_two",
    "tests/cell/test_image_agreement.py::test_a_grain_that_the_mesh_joins_keeps_or_loses_is_said",
    "plugins/fem_dolfinx/tests/test_form_cache.py::test_two_mpi_ranks_compile_once",
)


def pytest_addoption(parser):
    parser.addoption("--run-slow", action="store_true", help="also run the tests marked slow")


def pytest_collection_modifyitems(config, items):
    if config.getoption("--run-slow"):
        return
    skip = pytest.mark.skip(reason="slow; run with --run-slow")
    for item in items:
        # Not among the keywords: names of parameters are there too.
        if item.get_closest_marker("slow") or item.nodeid.startswith(SLOW):
            item.add_marker(skip)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """A class, or the functions of a file, stay on one worker, so that no set-up is done twice.

    Not by the marker 'xdist_group': pytest 9 pays no heed to how pytest-xdist 3.8 passes it on.
    """
    if config.getvalue("dist") != "loadscope":
        return None
    from xdist.scheduler import LoadScopeScheduling

    class Scheduling(LoadScopeScheduling):
        def _split_scope(self, nodeid):
            for name, places in TOGETHER.items():
                if nodeid.startswith(places):
                    return name
            return super()._split_scope(nodeid)

        def _assign_work_unit(self, node):
            def rank(scope):
                return next((i for i, start in enumerate(LONG) if scope.startswith(start)), len(LONG))

            self.workqueue.move_to_end(min(self.workqueue, key=rank), last=False)
            super()._assign_work_unit(node)

    return Scheduling(config, log)


def bad_skips(skipped):
    """Reasons, with their numbers, for which (file, line, reason) were skipped though everything is installed."""
    return Counter(
        reason.removeprefix("Skipped: ")
        for file, _, reason in skipped
        if not reason.removeprefix("Skipped: ").startswith(GOOD_REASONS)
        and not any(part in file or part in reason for part in OFFERED_BY_SOME)
    )


def _skipped(config):
    reporter = config.pluginmanager.get_plugin("terminalreporter")
    reports = reporter.stats.get("skipped", []) if reporter else []
    return [report.longrepr for report in reports if isinstance(report.longrepr, tuple)]


@pytest.hookimpl(tryfirst=True)
def pytest_sessionfinish(session, exitstatus):
    """With the variable CI set, a test that is skipped for want of something fails the run."""
    if os.environ.get("CI") and exitstatus == 0 and bad_skips(_skipped(session.config)):
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(terminalreporter, config):
    if not os.environ.get("CI"):
        return
    skipped = _skipped(config)
    bad = bad_skips(skipped)
    slow = sum(reason.removeprefix("Skipped: ").startswith("slow;") for *_, reason in skipped)
    terminalreporter.section("skipped")
    terminalreporter.line(
        f"{len(skipped)} skipped: {slow} for the slow suite, {len(skipped) - slow - bad.total()} that an "
        f"implementation does not offer or the machine cannot do, {bad.total()} for want of something, "
        "which is a failure here"
    )
    for reason, count in bad.most_common():
        terminalreporter.line(f"{count}: {reason}")
