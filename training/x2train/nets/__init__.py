"""Networks in torch and how they are trained: maps, temporal head, teachers, graphs."""
