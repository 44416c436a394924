"""What a reference depth says of a view: surfaces, what hides them, edges, thin things."""
