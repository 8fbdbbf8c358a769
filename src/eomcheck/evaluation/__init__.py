"""A scene and its formulations at one state: any numbers, doubles, balls."""
