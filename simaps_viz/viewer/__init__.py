"""The page on which a person sees, questions and drives on a map."""
