"""The mesh found by solving: audit, refine, place switches, impose couplings."""
