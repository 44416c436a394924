"""Programs that connect the validation to Starling."""
