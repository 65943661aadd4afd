"""Studies of the product on captures: modes, enhancers, budgets and ablations as tables, charts and pages."""
