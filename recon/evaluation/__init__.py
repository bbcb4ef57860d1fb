"""How far matchers are from the truth: data sets, protocols, measures, reports."""
