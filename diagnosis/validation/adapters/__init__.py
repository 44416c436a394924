"""Programs that connect the validation of the diagnosis to Starling."""
