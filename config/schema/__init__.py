"""The schema of a cell file: a module for each subject, a class `…Section` for each table."""
