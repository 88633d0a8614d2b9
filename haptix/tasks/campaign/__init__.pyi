from .plans import Campaign as Campaign
from .plans import CampaignTask as CampaignTask
from .plans import load_campaign as load_campaign
from .run import CampaignResult as CampaignResult
from .run import run_campaign as run_campaign
