"""Looking back at a run, from its folder alone; see `serp.review.step_account`."""
