"""Trainings and workflows in MLflow: a by-product, whose failure is a warning and never the end of a training.

store: a connection, and the SQLite database that it makes; run: the run of a training; workflow: the run above those of
its trainings, and what a finished workflow adds; model: the network as a model of MLflow; server: `relight ui`.
"""
