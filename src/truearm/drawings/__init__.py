"""What the domains draw: pages, figures, scenes and cards of arms, plans, models and verifications."""
