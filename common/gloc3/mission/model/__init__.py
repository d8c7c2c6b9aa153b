"""What a mission is: tasks, actions, arguments, conditions, policies, the fence and the legs of its path.

States and transitions are one table for all three levels.
"""
