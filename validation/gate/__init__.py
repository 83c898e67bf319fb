"""Is a fitted rig with a wrong cause refused on a fresh recording, and one with the right cause called better?"""
