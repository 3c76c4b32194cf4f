import pickle,math,statistics as S
runs=pickle.load(open('runs.pkl','rb'))
def judge(rule,name,head):
    det=0;fa=0;un=0;unm=0;lat=[];true=0
    for r in runs:
        st=rule[0]() ; stall_m=0;fired=False;last_st=None
        for x in r:
            true+=x[4]
            if x[5]:
                if last_st is None or x[0]-last_st>.6: stall_m=0
                stall_m+=x[3];last_st=x[0]
            h=x[6] and (head==2 or (head==1 and x[11]>=1.45))
            f=rule[1](st,x) or h
            if f:
                if last_st is not None and x[0]-last_st<1.2 and stall_m>.03: det+=1;lat.append(stall_m)
                else: fa+=1
                fired=True;break
            if last_st is not None and x[0]-last_st>.6:
                if stall_m>=.1: un+=1;unm+=stall_m
                stall_m=0;last_st=None
        if not fired and last_st is not None and stall_m>=.1: un+=1;unm+=stall_m
    print(name,'head',head,'detected',det,'metres till %.2f'%(S.mean(lat) if lat else 0),'false',fa,'unnoticed',un,'m %.1f'%unm,'true m %.0f'%true)
none=(dict,lambda s,x:False)
for h in(2,1): judge(none,'HEAD',h)
def rule(gi,K,th,turn,agg='med',nth=9,minv=.06):
    dt=1.5 if gi==9 else 3
    def init(): return {'v':[],'h':[]}
    def r(s,x):
        s['h'].append((x[0],x[1],x[2]))
        if x[gi]==9: return False
        if x[0]-s['h'][0][0]<dt: return False
        h0=[h for h in s['h'] if h[0]>=x[0]-dt-.3]
        if max(h[1] for h in h0)-min(h[1] for h in h0)>math.radians(turn): return False
        if h0[-1][2]-h0[0][2]<minv*dt: return False
        a=x[gi] if nth==9 else max(x[gi],x[gi+1]-nth+th)
        s['v'].append(a);v=s['v'][-K:]
        m=S.median(v) if agg=='med' else sum(max(-1,min(1,q)) for q in v)/len(v)
        return len(v)>=K and m<th
    return init,r
for h in(2,1):
  for agg in('med','mean'):
    for K in(4,5,6):
      for th in(-.15,-.1,-.05):
        for turn in(6,12,25):
          judge(rule(9,K,th,turn,agg),'%s K%d th%.2f turn%d'%(agg,K,th,turn),h)
